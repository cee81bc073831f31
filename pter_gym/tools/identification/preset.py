"""The result as a preset, which every command that takes a machine takes."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import PurePath
from types import MappingProxyType
from typing import cast

from pter_gym.params import preset_of as machine_preset
from pter_gym.params._preset import Preset
from pter_gym.tools.identification.identifying import Finding, Identification


def preset_of(found: Identification, base: Preset) -> Preset:
    """Return a preset with what was identified; path, hand, controller and Delrin are those of ``base``."""
    origins = dict(base.provenance)
    by_place: dict[str, list[Finding]] = {}
    for finding in found.findings:
        if finding.quantity.place:
            by_place.setdefault(finding.quantity.place, []).append(finding)
    name = plain(PurePath(found.log.name).name)
    for place, told in by_place.items():
        origins[place] = origin(told, name)
    for place in ("arm.length_a", "arm.length_b", "clutch.voltage_max"):
        origins[place] = "chosen: stated to pter identify, or that of its start"
    preset = machine_preset(found.machine, base)
    provenance = cast("Mapping[str, str]", MappingProxyType(origins))
    return replace(preset, sensing=replace(base.sensing, delay=max(found.delay, 0.0)), provenance=provenance)


def origin(told: list[Finding], log: str) -> str:
    """Return the provenance of a number, or of several of one field."""
    parts = [_origin_of(finding) for finding in told]
    kind = "chosen" if all(finding.status == "kept" for finding in told) else "identified"
    return f"{kind}: from {log}, {'; '.join(parts)}"


def _origin_of(finding: Finding) -> str:
    if finding.status == "kept":
        return f"not shown by it and kept: {plain(finding.reason)}"
    relative = ", relative to the inertia of link A" if finding.relative else ""
    unsure = "uncertain, " if finding.status == "uncertain" else ""
    return f"{unsure}95 % interval {finding.low:.4g} to {finding.high:.4g}{relative}"


def plain(text: str) -> str:
    """Return text as one line without what a preset does not admit."""
    return "".join(c if c.isprintable() and c not in '"\\' else "_" for c in text)
