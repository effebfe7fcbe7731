"""The sea: current, waves, floor, density and the ways of sound, as one `Environment`.

Takes an `Ocean` of settings, or `SeaSettings` (`assembly`); gives an `Environment`, whose parts are
of any class with the same methods (`currents`, `floors`, `rays`): compiled code chooses a method by
the type of a part.

Imports: laisn sim.attitude sim.scenario sim.system
"""
