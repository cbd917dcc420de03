"""`python -m dlolib.cli` is `dlo`."""

from dlolib.cli import main

if __name__ == "__main__":
    main()
