"""Searches where linear fits do not suffice: moving parts, damaged teeth, sizes, planet orders."""
