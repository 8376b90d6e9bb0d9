import sys
from pathlib import Path

# The synthetic pictures are shared by this folder's tests and by bench/.
sys.path.insert(0, str(Path(__file__).parent))
