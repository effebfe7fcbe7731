"""The mission in 3D on a page: data of a flight, or of a replay on a measured log, for the script
of the scene, `replay.js`, which `make bundle` builds from `src/`.

Takes flights and measurements; knows no page.

Imports: laisn sim
"""
