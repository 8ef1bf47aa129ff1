"""``python -m ctlabs`` is the command ``ctlabs``."""

from ctlabs.cli import main

if __name__ == "__main__":
    main()
