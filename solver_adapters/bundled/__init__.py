"""The bundled solver: quadratic tetrahedra, crystal plasticity, exact sensitivities."""
