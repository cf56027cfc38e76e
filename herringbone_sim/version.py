"""Version of the package, which recordings and caches store too."""

VERSION = "0.1.0"
