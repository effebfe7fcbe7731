"""Hulls from Gazebo's models (SDF 1.4 to 1.12) with gz-sim's underwater plugins.

`hull.from_sdf` gives the hull file, and a remark for all that was assumed or left out. In between:
elements (`document`, `includes`), frames (`frames`), one rigid body of all links (`body`), and a
module for each plugin (`hydrodynamics`, `thrusters`, `fins`, `buoyancy`).

Imports: laisn sim.system sim.vehicle sim.water
"""
