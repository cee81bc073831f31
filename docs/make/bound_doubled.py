"""Other rollouts to begin `docs/make/bound.py` of commit c4ffb27 with: `bound_doubled.py OUT 3 6 0:standard:slow …`.

Those of rank 3 to 5 among all laws and policies; a run is a block of episodes, a scenario and a pace. The best of a
run's result and of that in bound.jsonl has twice the effort.
"""

import json
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
import bound

out, first, last, *runs = sys.argv[1:]
source = Path(bound.__file__).read_text("utf-8")
code = source[source.index("def one(") : source.index("def known(")]
code = code.replace("[:STARTS]", f"[{first}:{last}]").replace("reshape(STARTS", f"reshape({last} - {first}")
exec(code.replace("rng([FRESH,", f"rng([FRESH, {first},"), vars(bound))
for each in runs:
    block, scenario, pace = each.split(":")
    found = bound.one(bound.Run(int(block), scenario, pace))
    line = json.dumps([[int(block), scenario, pace], int(first), int(last), found["bound"], found["seconds"]])
    with Path(out).open("a") as file:
        print(line, file=file)
