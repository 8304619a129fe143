"""``python -m mpcplan``: the command line."""

from mpcplan.cli import entry

if __name__ == "__main__":
    entry()
