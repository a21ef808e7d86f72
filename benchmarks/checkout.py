"""The checkout that this file belongs to, first on the path of this process and its children.

Import it before the packages of the suite: an installed version would be measured instead.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]

sys.path.insert(0, str(ROOT))
_others = [word for word in os.environ.get('PYTHONPATH', '').split(os.pathsep) if word]
os.environ['PYTHONPATH'] = os.pathsep.join([str(ROOT), *_others])
os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
