"""``python -m insnav``: the command line."""

from insnav.cli import main

if __name__ == "__main__":
    main()
