"""The public Python interface, ``import herringbone_sim as hb``: functions and their results.

``NAMES`` maps each name to its module, from which ``hb`` imports it when it is first used.
"""

NAMES = {
    "Parameters": "herringbone_sim.core.parameters",
    "load_gear": "herringbone_sim.recording.parameter_file",
    "simulate": "herringbone_sim.api.run",
    "read_run": "herringbone_sim.api.run",
    "Run": "herringbone_sim.api.run",
    "largest_exponent": "herringbone_sim.api.exponent",
    "exponents": "herringbone_sim.api.exponent",
    "bifurcation": "herringbone_sim.api.bifurcation",
    "orbits": "herringbone_sim.api.orbits",
    "basins": "herringbone_sim.api.basins",
    "catalogue": "herringbone_sim.api.diagnosis",
    "Campaign": "herringbone_sim.api.diagnosis",
    "diagnose": "herringbone_sim.api.diagnosis",
    "HerringboneError": "herringbone_sim.errors",
}
