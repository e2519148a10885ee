"""Code_Aster, called as a program: MONOCRISTAL on quadratic tetrahedra, backward Euler."""
