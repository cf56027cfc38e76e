"""Effects that the nominal model leaves out, shared by simulation and diagnosis."""
