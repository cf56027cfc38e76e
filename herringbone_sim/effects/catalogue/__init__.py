"""The effects, one file each: a module with ``EFFECT`` in this folder is all that it takes."""
