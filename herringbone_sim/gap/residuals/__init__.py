"""Where the nominal gear, inside its tolerance, misses the recording."""
