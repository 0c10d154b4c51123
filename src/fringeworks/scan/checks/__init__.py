"""What projector and camera can do: one check in each file, for the set-up."""
