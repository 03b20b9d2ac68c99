"""``python -m grassfire`` is the command ``grassfire``."""

from grassfire.cli import main

if __name__ == "__main__":
    main()
