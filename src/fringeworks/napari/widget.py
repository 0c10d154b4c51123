"""The widget of napari that measures two frames which are layers."""

from __future__ import annotations

import ast
from importlib import import_module
from types import GenericAlias
from typing import Any

import numpy as np

from fringeworks.napari.layers import layers_of
from fringeworks.pair.analyse import methods
from fringeworks.pipeline.pairs import reconstruct
from fringeworks.types import InputError, MissingPackage, Pair

USUAL = "windowed"
"""Method that is chosen at first."""


def options_of(text: str) -> dict[str, Any]:
    """Read options of a method as they are written in Python: ``iterations=3, paint=False``.

    Raises
    ------
    InputError that says what was expected.
    """
    try:
        call = ast.parse(f"f({text})", mode="eval").body
        assert isinstance(call, ast.Call)
        assert not call.args
        return {str(k.arg): ast.literal_eval(k.value) for k in call.keywords}
    except (SyntaxError, ValueError, AssertionError) as error:
        raise InputError(
            f"options: expected such as iterations=3, paint=False, got {text!r}"
        ) from error


def measured_layers(reference: Any, object_: Any, method: str, options: str) -> list[Any]:
    """Measure the displacement or height of two layers of images.

    Parameters
    ----------
    reference, object_ : layers of images (h, w)
    method : str
        One of ``fringeworks.methods()``.
    options : str
        Options of the method, such as ``iterations=3``.

    Returns
    -------
    list of (data, options, kind) for napari.
    """
    for role, layer in (("reference", reference), ("object", object_)):
        if layer is None:
            raise InputError(f"{role}: expected a layer with an image, got none")
    pair = Pair(np.asarray(reference.data), np.asarray(object_.data))
    found = reconstruct(pair, method, **options_of(options))
    return layers_of(found, str(object_.name))


def pair_widget() -> Any:
    """Return the widget: two layers, a method, its options, and a button.

    Raises
    ------
    MissingPackage where the package ``magicgui``, which napari brings, is not installed.
    """
    try:
        magicgui = import_module("magicgui").magicgui
        image = import_module("napari.layers").Image
        layer_data = import_module("napari.types").LayerDataTuple
    except ModuleNotFoundError as error:
        raise MissingPackage(
            "the widget: expected the package napari, got none; pip install 'fringeworks[napari]'"
        ) from error

    def measure(reference: Any, object_: Any, method: Any, options: Any) -> Any:
        return measured_layers(reference, object_, method, options)

    measure.__annotations__ = {
        "reference": image,
        "object_": image,
        "method": str,
        "options": str,
        "return": GenericAlias(list, (layer_data,)),
    }
    return magicgui(
        measure,
        call_button="Measure",
        object_={"label": "object"},
        method={"choices": list(methods()), "value": USUAL},
        options={"value": ""},
    )
