import importlib.util
import sys
from pathlib import Path

_path = Path(__file__).with_name("scenes.py")
_spec = importlib.util.spec_from_file_location("scenes", _path)
scenes = importlib.util.module_from_spec(_spec)
sys.modules.setdefault("scenes", scenes)
_spec.loader.exec_module(scenes)
