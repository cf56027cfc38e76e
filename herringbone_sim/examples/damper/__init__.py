"""A machine of one's own for the diagnosis: one mass with play, spring and damper.

python -m herringbone_sim.examples.damper --effect stribeck --seed 3
"""
