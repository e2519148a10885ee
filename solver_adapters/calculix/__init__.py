"""CalculiX, called as a program: small strain, the twelve {110}⟨111⟩ systems, backward Euler."""
