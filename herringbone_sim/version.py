"""The version, for the package and for what it records."""

VERSION = "0.1.0"
