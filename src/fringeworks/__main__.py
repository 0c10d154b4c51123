"""``python -m fringeworks``."""

from fringeworks.cli import main

if __name__ == "__main__":
    main()
