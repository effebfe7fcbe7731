"""MCAP logs: of flights, for Foxglove and Rerun and read back to the bit; of real vehicles; tables
of them; recovery.

Imports: laisn sim.attitude sim.flight sim.scenario sim.sensing sim.system
sim.trajectory sim.vehicle sim.water
"""
