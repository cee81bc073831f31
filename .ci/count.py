"""Print a table of pytest's reports in a folder and of nox's reports, then `N passed, N failed`."""

import json
import sys
import xml.etree.ElementTree as ET
from collections import Counter
from pathlib import Path

folder, *reports = map(Path, sys.argv[1:])
whole = [report for report in reports if report.exists()]
sessions = [each for report in whole for each in json.loads(report.read_text("utf-8"))["sessions"]]
totals: Counter[str] = Counter(failed=len(reports) - len(whole))
print("\n| Session | Outcome | Tests | Seconds |\n|---|---|---|---:|")
for session in sessions:
    tests: Counter[str] = Counter()
    name = (session["signatures"] or [session["name"]])[0]
    for file in (folder / name).glob("*.xml"):
        for case in ET.parse(file).iter("testcase"):
            kinds = {"failure": "failed", "error": "failed", "skipped": "skipped"}
            tests[next((kinds[each.tag] for each in case if each.tag in kinds), "passed")] += 1
    # a session that reports no tests counts as one check, and so does a failed one whose tests all
    # passed
    told = (
        ", ".join(f"{tests[kind]} {kind}" for kind in ("passed", "failed", "skipped"))
        if tests
        else ""
    )
    print(f"| {name} | {session['result']} | {told} | {session.get('duration', 0):.0f} |")
    totals["passed"] += tests["passed"] or int(session["result"] == "success")
    totals["failed"] += tests["failed"] or int(session["result"] in ("failed", "aborted"))
print(f"\n{totals['passed']} passed, {totals['failed']} failed")
sys.exit(totals["failed"] > 0)
