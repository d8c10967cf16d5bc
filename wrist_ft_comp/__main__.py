"""``python -m wrist_ft_comp`` is the command ``wrist_ft_comp``."""

import sys

from wrist_ft_comp.cli.entry import main

if __name__ == '__main__':
    sys.exit(main())
