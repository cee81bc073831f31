"""Print constraints that hold every dependency of the core and of the tests to the lowest version that is promised."""

import re
import sys
import tomllib
from pathlib import Path

project = tomllib.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))["project"]
for requirement in project["dependencies"] + project["optional-dependencies"]["test"]:
    promised = re.match(r"([\w-]+)>=([\w.]+)", requirement)
    if promised:
        print(f"{promised[1]}=={promised[2]}")
