"""Example of a machine for the diagnosis engine: one mass with play, spring and damper.

python -m herringbone_sim.examples.damper --effect stribeck --seed 3
"""
