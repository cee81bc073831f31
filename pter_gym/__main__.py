"""``python -m pter_gym`` is ``pter``."""

import sys

from pter_gym._commands.main import main

sys.exit(main())
