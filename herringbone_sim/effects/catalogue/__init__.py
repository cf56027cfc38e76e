"""Effects of the catalogue: ``effects.registry`` collects ``EFFECT`` of every module here."""
