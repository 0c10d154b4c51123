"""Checks the conda recipe: conda's own parser renders it for every platform."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import rattler_build

RECIPE = Path(__file__).parent / "conda" / "recipe.yaml"
PLATFORMS = ("linux-64", "linux-aarch64", "osx-64", "osx-arm64", "win-64")
VARIANT = """
is_abi3: [true]
c_compiler: [gcc]
rust_compiler: [rust]
c_stdlib: [sysroot]
c_stdlib_version: ["2.28"]
python: ["3.11.* *_cpython"]
"""
"""What conda-forge's pins give a recipe: any values serve to render it."""


def main() -> int:
    argparse.ArgumentParser(description=__doc__).parse_args()
    recipe = rattler_build.Stage0Recipe.from_file(str(RECIPE))
    for name in PLATFORMS:
        platform = rattler_build.PlatformConfig(target_platform=name)
        variants = recipe.render(
            rattler_build.VariantConfig.from_yaml(VARIANT),
            rattler_build.RenderConfig(platform=platform),
        )
        for variant in variants:
            package = variant.recipe.package
            print(f"{name}: {package.name} {package.version}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
