"""Several views of one part: their poses, how they fit together, and the part that they show."""
