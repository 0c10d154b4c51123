"""Write service-openapi.json: the interface of ``fringeworks serve`` as it is in the code."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from fringeworks.service.api import service_app

TARGET = Path(__file__).with_name("service-openapi.json")


def document() -> dict[str, Any]:
    """The OpenAPI document; making it needs no scanner."""
    nothing: Any = None
    return service_app(nothing).openapi()


if __name__ == "__main__":
    TARGET.write_text(json.dumps(document(), indent=1, ensure_ascii=False) + "\n", "utf-8")
