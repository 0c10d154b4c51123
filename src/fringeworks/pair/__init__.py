"""Two frames, or one: from fringes to displacements and heights over a reference plane."""
