"""The effects of the catalogue, one file each: a module here with ``EFFECT`` is found by
itself.
"""
