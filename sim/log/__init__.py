"""Flights as MCAP logs that Foxglove and Rerun draw, and back.

Takes a `Flight` and writes it (`writer`); reads one back to the bit, or the measurements of a real vehicle (`reader`),
exports tables and repairs the log of a crash. It must not fly, sense or navigate anything: what it reads is what was
logged, or an error.

Imports: laisn sim.assembly sim.attitude sim.flight sim.scenario sim.system sim.trajectory sim.vehicle
"""
