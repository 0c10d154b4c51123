"""One file for each step of the studio; each has one function, ``build``."""
