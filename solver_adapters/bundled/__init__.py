"""The bundled solver: crystal plasticity on quadratic cells, with exact sensitivities."""
