"""What a film shows of followers on stations.

Takes a flight, places of vehicles and a scale; gives lines in the water, which the overlay draws. Knows no camera.

Imports: laisn sim.flight sim.station_keeping
"""
