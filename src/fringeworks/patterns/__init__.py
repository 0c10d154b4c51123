"""What the projector shows: plans of shifted fringes and Gray code, and their pictures."""
