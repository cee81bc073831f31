"""What the checks came to."""

import enum
from dataclasses import dataclass


class Outcome(enum.IntEnum):
    """What a check came to; the larger, the worse."""

    OK = 0
    MISSING = 1
    FAILED = 2


@dataclass(frozen=True)
class Finding:
    """What one check came to in one autoreset mode, with a sentence about it."""

    check: str
    mode: str
    outcome: Outcome
    sentence: str

    def __str__(self) -> str:
        return f"{self.outcome.name.lower():<7}  {self.mode:<9}  {self.check:<21}  {self.sentence}"


@dataclass(frozen=True)
class Report:
    """All findings about one environment."""

    findings: tuple[Finding, ...]

    @property
    def ok(self) -> bool:
        """Whether nothing failed; what is missing does not count."""
        return not self.checks(Outcome.FAILED)

    def checks(self, outcome: Outcome) -> set[str]:
        """Return the names of the checks that came to an outcome in at least one mode."""
        return {finding.check for finding in self.findings if finding.outcome == outcome}

    def __str__(self) -> str:
        return "\n".join(map(str, self.findings))
