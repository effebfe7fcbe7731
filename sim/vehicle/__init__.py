"""One fleet of rigid hulls in the water, from MJCF to motion.

Takes the MJCF files of `models`, where all coefficients live, an `Ocean` and commands of effectors;
gives pose, velocity and states of effectors after each step (`plant`). In between: names resolved
once (`mjcf`), coefficients and effectors as records, and the forces of the water in Fossen's form
(`hydrodynamics`). It does not depend on where vehicles are to go.

Imports: laisn models sim.attitude sim.scenario sim.water
"""
