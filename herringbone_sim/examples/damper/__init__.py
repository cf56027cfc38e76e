"""Example of a machine other than a gear that the diagnosis engine can treat: one mass with play,
spring and damper.

python -m herringbone_sim.examples.damper --effect stribeck --seed 3
"""
