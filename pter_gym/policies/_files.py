"""Policies as files: ``NAME.json`` is the card, ``NAME.safetensors`` the weights; ``NAME.md`` is for people.

Nothing in these files can be executed. Sizes, names, shapes, types and checksums are checked before any number is used.
"""

import hashlib
import json
import os
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load as load_tensors
from safetensors.numpy import save as save_tensors

from pter_gym._internal.files import FilePath, find_path, write_files_atomic
from pter_gym._internal.locks import locked
from pter_gym._internal.reading import parse_json, read_bytes, reading
from pter_gym.errors import DataError, ParameterError, nearest, unknown_name
from pter_gym.policies._cards import Card, read_card
from pter_gym.policies._network import LSTM, Network
from pter_gym.policies._neural import Neural

SHIPPED = Path(__file__).parent / "shipped"
"""Where the package keeps its trained policies."""

NAME = re.compile(r"[a-z0-9]+(-[a-z0-9]+)*")
"""What a policy may be called."""

LONGEST_NAME = 180
"""Most characters of a policy's name, as it is in the name of a file."""

CARD, WEIGHTS, TEXT = ENDINGS = (".json", ".safetensors", ".md")
"""How the files of a policy end."""

RUN = "run.json"
"""File in the folder of a training run, which is not a policy yet."""

MOST_CARD, MOST_WEIGHTS = 1 << 20, 1 << 24
"""Largest files [B]; the header of the weights may be as large as a card."""

SIZE = 8
"""Bytes at the start of a file of weights that say how long its header is."""


def shipped_policies(folder: FilePath = SHIPPED) -> tuple[str, ...]:
    """Return the names of the trained policies in a folder; by default, of those that the package ships."""
    found = find_path("folder", folder).glob(f"*{CARD}")
    return tuple(sorted(path.stem for path in found if NAME.fullmatch(path.stem)))


def exported_policies(folder: FilePath = Path()) -> tuple[str, ...]:
    """Return the names of the policies in a folder that have both card and weights; by default, the current one."""
    where = find_path("folder", folder)
    return tuple(name for name in shipped_policies(where) if (where / f"{name}{WEIGHTS}").is_file())


def is_path(name: str) -> bool:
    """Tell whether a name means the files of an exported policy: it has a folder or one of the extensions."""
    return "/" in name or name != Path(name).name or name.endswith(ENDINGS) or name in ("~", ".", "..")


def is_here(name: str) -> bool:
    """Tell whether the current folder has an exported policy or a folder of this name."""
    return name in exported_policies() or find_path("policies", name).is_dir()


def read_policy(name: FilePath, folder: FilePath | None = None) -> Neural:
    """Return a trained policy as a controller, which acts once bound to a machine and a layout.

    ``pter_gym.load_policy`` returns one that is ready to act in an environment.

    Parameters
    ----------
    name
        The name of a shipped policy or of one in the current folder, or the path of an exported one: ``folder/name``,
        with or without the extension of one of its files, or a folder with only that policy.
    folder
        Folder of its files, for a name without a path.

    Raises
    ------
    ParameterError
        If a policy cannot have this name, or there is none by it; the message suggests the nearest.
    DataError
        If a file is missing, too large or malformed; nothing in it was executed.
    """
    if folder is not None:
        where = find_path("folder", folder)
        return _load(_known(name, shipped_policies(where)), where)
    find_path("name", name)
    text = os.fspath(name)
    if isinstance(name, os.PathLike) or is_path(text) or (text not in shipped_policies() and is_here(text)):
        return _load(*find_exported(name))
    return _load(_known(text, shipped_policies()), SHIPPED)


def _known(name: object, known: Sequence[str]) -> str:
    """Return a name, or raise a ParameterError unless it is one of the known ones."""
    check_name(name)
    if name not in known:
        raise unknown_name("policies", name, known)
    return str(name)


def find_exported(path: FilePath) -> tuple[str, Path]:
    """Return name and folder of an exported policy.

    Parameters
    ----------
    path
        ``folder/name``, with or without the extension of one of its files, or a folder with only that policy.

    Raises
    ------
    ParameterError
        If there is none, or several; the message suggests the nearest.
    """
    given = find_path("policies", path)
    named = given.with_suffix("") if given.suffix in ENDINGS else given
    if (named.parent / f"{named.name}{CARD}").is_file():
        return named.name, named.parent
    inside = exported_policies(given)
    if len(inside) == 1:
        return inside[0], given
    if inside:
        why = f"the folder holds several, {', '.join(str(given / name) for name in inside)}"
    elif (given / RUN).is_file():
        why = f"it is the folder of a training, of which `pter export {given}` makes a policy"
    else:
        known = [str(named.parent / name) for name in exported_policies(named.parent)]
        why = f"no {named}{CARD}{nearest(named, known)}"
    raise ParameterError(f"policies: there is no exported policy {os.fspath(path)!r}: {why}")


def _load(name: str, folder: Path) -> Neural:
    check_name(name)
    card = read_card(_read(folder / f"{name}{CARD}", MOST_CARD), f"{name}{CARD}")
    if card.name != name:
        raise DataError(f"policy card {name}{CARD} is refused: it belongs to {card.name!r}")
    path = folder / f"{name}{WEIGHTS}"
    data = _read(path, MOST_WEIGHTS)
    found = hashlib.sha256(data).hexdigest()
    if found != card.weights_sha256:
        raise DataError(f"policy {path} is refused: SHA-256 is {found}, its card says {card.weights_sha256}")
    return Neural(card, read_network(data, card, str(path)))


def read_network(data: bytes, card: Card, what: str) -> Network:
    """Return the network stored in the bytes of a weights file.

    Parameters
    ----------
    data
        The file's content.
    card
        The card that it must fit.
    what
        The file's name, for messages.

    Raises
    ------
    DataError
        If a tensor is missing, unknown, of another shape or type, or has numbers that are not finite.
    """
    with reading(f"policy {what} is refused"):
        tensors = _tensors(data)
    shapes = card.shapes
    if set(tensors) != set(shapes):
        raise DataError(
            f"policy {what} is refused: it must hold {', '.join(sorted(shapes))}, it holds {', '.join(sorted(tensors))}"
        )
    for name, shape in shapes.items():
        tensor = tensors[name]
        if tensor.dtype != np.float32 or tensor.shape != shape:
            raise DataError(
                f"policy {what} is refused: {name} must be float32 {shape}, it is {tensor.dtype} {tensor.shape}"
            )
        if not np.isfinite(tensor).all():
            raise DataError(f"policy {what} is refused: {name} holds numbers that are not finite")
    layers = range(len(card.hidden) + 1)
    values = {name: tensor.astype(np.float64) for name, tensor in tensors.items()}
    return Network(
        tuple(values[f"layer_{k}.weight"] for k in layers),
        tuple(values[f"layer_{k}.bias"] for k in layers),
        card.squashed,
        LSTM(values["lstm.weight_inputs"], values["lstm.weight_hidden"], values["lstm.bias"]) if card.lstm else None,
    )


def _tensors(data: bytes) -> dict[str, NDArray[Any]]:
    """Return the tensors in a weights file; the library itself would accept a header with a duplicate name."""
    size = int.from_bytes(data[:SIZE], "little")
    parse_json(data[SIZE : SIZE + size], MOST_CARD)
    try:
        return load_tensors(data)
    except SafetensorError as error:
        raise ValueError(str(error)) from None


def write_policy(card: Card, tensors: dict[str, NDArray[np.float32]], text: str, folder: FilePath) -> Path:
    """Write a policy and return the path of its card, which is written last.

    Parameters
    ----------
    card
        The card; its checksum is set here.
    tensors
        Weights under the names of ``Card.shapes``.
    text
        Model card in Markdown.
    folder
        Folder for the files; it must exist.

    Raises
    ------
    ParameterError
        If a policy cannot have this name.
    DataError
        If the weights do not fit the card.
    StorageError
        If they cannot be written.
    """
    check_name(card.name)
    folder = find_path("folder", folder)
    data = save_tensors({name: np.ascontiguousarray(tensors[name]) for name in sorted(tensors)})
    card = replace(card, weights_sha256=hashlib.sha256(data).hexdigest())
    content = json.dumps(card.as_json(), indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    read_network(data, read_card(content.encode(), card.name), card.name)
    parts = {WEIGHTS: data, TEXT: text.encode(), CARD: content.encode()}
    with locked(folder / f".{card.name}.lock"):
        write_files_atomic(folder, {f"{card.name}{ending}": part for ending, part in parts.items()})
    return folder / f"{card.name}{CARD}"


def check_name(name: object) -> None:
    """Raise a ParameterError unless a policy may have this name, which is never a path."""
    if not isinstance(name, str) or len(name) > LONGEST_NAME or not NAME.fullmatch(name):
        raise ParameterError(
            f"policies must have names of small letters, digits and single hyphens, at most {LONGEST_NAME} of them, "
            f"got {name!r:.200}"
        )


def _read(path: Path, most: int) -> bytes:
    with reading(f"policy file {path} is refused"):
        return read_bytes(path, most)
