"""Everything that touches a disk, one file for each kind."""
