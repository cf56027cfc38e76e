"""What the nominal model leaves out: effects that the simulation and the diagnosis share."""
