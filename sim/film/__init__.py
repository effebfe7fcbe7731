"""What `sim.film.render` films with: the graphics library, scene, cameras and overlay."""
