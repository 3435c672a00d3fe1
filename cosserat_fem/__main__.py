"""python -m cosserat_fem"""

import sys

from .cli import main

sys.exit(main())
