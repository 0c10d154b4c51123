"""What the studio and the service stand on: guard, address, and work in a process of its own."""
