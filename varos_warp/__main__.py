"""Run the command line: python -m varos_warp."""

from varos_warp.cli import main

if __name__ == "__main__":
    main()
