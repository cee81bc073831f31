"""Trained policies as files: ``NAME.safetensors`` holds the weights, and the card as JSON.

The card says how the network is connected (``interface``) and how it was trained (``about``).
Nothing in a file is executed.
"""

import json
import os
import re
import struct
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load as load_tensors, save as save_tensors

from pter_gym._internal.codec import Codec
from pter_gym._internal.files import FilePath, expand_path, write_bytes_atomic
from pter_gym._internal.reading import parse_json, read_bytes, reading
from pter_gym.errors import ParameterError, nearest, unknown_name

if TYPE_CHECKING:
    from pter_gym.policies._trained import TrainedController

SHIPPED = Path(__file__).parent / "shipped"
"""Where the package keeps its trained policies."""

FORMAT = "pter-gym policy 1"
"""Name and version of the format."""

NAME = re.compile(r"[a-z0-9]+(-[a-z0-9]+)*")
"""Names of policies."""

MAX_NAME_LENGTH = 180
"""Most characters of a policy's name, as it is in the name of a file."""

ENDING = ".safetensors"

RUN = "run.json"
"""File in the folder of a training run, which is not a policy yet."""

MAX_HEADER, MAX_FILE = 1 << 20, 1 << 24
"""Largest header, which holds the card, and largest file [B]."""


def shipped_policies() -> tuple[str, ...]:
    """Return the names of the trained policies that the package ships."""
    return policies_in(SHIPPED)


def policies_in(folder: FilePath = Path()) -> tuple[str, ...]:
    """Return the names of the policies in a folder; by default, the current one."""
    found = expand_path("folder", folder).glob(f"*{ENDING}")
    return tuple(sorted(path.stem for path in found if NAME.fullmatch(path.stem)))


def is_path(name: str) -> bool:
    """Return whether a name is the path of a policy: it has a folder or the ending."""
    return (
        "/" in name or name != Path(name).name or name.endswith(ENDING) or name in ("~", ".", "..")
    )


def is_here(name: str) -> bool:
    """Return whether the current folder has a policy or a folder of this name."""
    return name in policies_in() or expand_path("policies", name).is_dir()


def read_policy(name: FilePath) -> "TrainedController":
    """Return a trained policy as a law, which acts once bound to a machine and a layout.

    ``pter_gym.load_policy`` returns one that is ready to act in an environment.

    Parameters
    ----------
    name
        The name of a shipped policy or of one in the current folder; or a path, ``folder/name``
        with or without ``.safetensors``, or that of a folder with only one policy.

    Raises
    ------
    ParameterError
        If a policy cannot have this name, or none has it; the message suggests the nearest.
    DataError
        If the file is too large or malformed.
    """
    path = find_file(name)
    check_name(path.stem)
    with reading(f"policy {path} is refused"):
        return _parse(read_bytes(path, MAX_FILE), path.stem)


def find_file(name: FilePath) -> Path:
    """Return the file of a policy; see ``read_policy``."""
    path = expand_path("policies", name)
    if not isinstance(name, os.PathLike) and not is_path(name):
        if name in shipped_policies():
            return SHIPPED / f"{name}{ENDING}"
        if not is_here(name):
            check_name(name)
            raise unknown_name("policies", name, shipped_policies())
    file = path.parent / f"{path.name.removesuffix(ENDING)}{ENDING}"
    if file.is_file():
        return file
    inside = policies_in(path)
    if (path / RUN).is_file():
        why = f"it is the folder of a training, of which `pter export {path}` makes a policy"
    elif len(inside) == 1:
        return path / f"{inside[0]}{ENDING}"
    elif inside:
        why = f"the folder holds several, {', '.join(str(path / each) for each in inside)}"
    else:
        names = [str(file.parent / each) for each in policies_in(file.parent)]
        why = f"no {file}{nearest(file.with_suffix(''), names)}"
    raise ParameterError(f"policies: there is no trained policy {os.fspath(name)!r}: {why}")


def write_policy(policy: "TrainedController", path: FilePath) -> Path:
    """Write a policy to ``path``, whose stem becomes its name, and return the path of the file.

    Raises
    ------
    ParameterError
        If a policy cannot have this name, or its network is too large.
    StorageError
        If it cannot be written.
    """
    path = expand_path("path", path)
    check_name(path.name.removesuffix(ENDING))
    path = path.parent / f"{path.name.removesuffix(ENDING)}{ENDING}"
    write_bytes_atomic(path, encode_policy(policy))
    return path


def encode_policy(policy: "TrainedController") -> bytes:
    """Return the bytes of a policy's file, or raise a ParameterError if it has no such file."""
    tensors: dict[str, NDArray[Any]] = {}
    for k, (weight, bias) in enumerate(policy.layers):
        tensors |= {
            f"layer_{k}.weight": np.ascontiguousarray(weight),
            f"layer_{k}.bias": np.ascontiguousarray(bias),
        }
    card = {"interface": interface_codec().to_plain(policy.interface), "about": dict(policy.about)}
    text = json.dumps(card, ensure_ascii=False, allow_nan=False)
    data = save_tensors(tensors, {"format": FORMAT, "card": text})
    if len(data) > MAX_FILE:
        raise ParameterError(
            f"layers must fit into a file of {MAX_FILE} bytes, got {policy.sizes} with {len(data)}"
        )
    _parse(data, policy.name)
    return data


def check_name(name: object) -> None:
    """Raise a ParameterError unless a policy may have this name, which is never a path."""
    if not isinstance(name, str) or len(name) > MAX_NAME_LENGTH or not NAME.fullmatch(name):
        raise ParameterError(
            "policies must have names of lower-case letters, digits and single hyphens, "
            f"at most {MAX_NAME_LENGTH} of them, "
            f"got {name!r:.200}"
        )


def read_header(data: bytes) -> dict[str, str]:
    """Return the metadata of a safetensors file, or raise a ValueError."""
    (size,) = struct.unpack_from("<Q", data.ljust(8, b"\0"))
    header = parse_json(data[8 : 8 + size], MAX_HEADER)
    return dict(header.get("__metadata__", {}))


def _parse(data: bytes, name: str) -> "TrainedController":
    """Return the policy in the bytes of a file."""
    from pter_gym.policies._interface import Interface
    from pter_gym.policies._trained import TrainedController

    header = read_header(data)
    if header.get("format") != FORMAT:
        raise ValueError(f"format must be {FORMAT!r}, got {header.get('format')!r:.40}")
    card = parse_json(header["card"].encode(), MAX_HEADER)
    interface = interface_codec().from_plain(card["interface"])
    if not isinstance(interface, Interface):
        raise ValueError("interface must be an Interface")
    try:
        tensors = load_tensors(data)
    except SafetensorError as error:
        raise ValueError(str(error)) from None
    count = len(tensors) // 2
    expected = {f"layer_{k}.{part}" for k in range(count) for part in ("weight", "bias")}
    if set(tensors) != expected:
        raise ValueError(
            "it must hold weight and bias of each layer, "
            f"it holds {', '.join(sorted(tensors)):.200}"
        )
    layers = tuple((tensors[f"layer_{k}.weight"], tensors[f"layer_{k}.bias"]) for k in range(count))
    return TrainedController(interface, layers, name, dict(card["about"]))


def interface_codec() -> Codec:
    from pter_gym.controllers import CONTROLLERS, Guided, PaceSchedule, Powers, Scaled
    from pter_gym.policies._interface import Input, Interface, Interval

    guided = [kind for kind in CONTROLLERS.values() if issubclass(kind, Guided)]
    return Codec((Interface, Input, Interval, PaceSchedule, Powers, Scaled, *guided))
