"""Flights as MCAP logs that Foxglove and Rerun draw, and back.

Writes a `Flight`, reads it back to the bit, or the measurements of a real vehicle; exports tables, recovers logs.

Imports: laisn sim.assembly sim.attitude sim.flight sim.scenario sim.system sim.trajectory sim.vehicle
"""
