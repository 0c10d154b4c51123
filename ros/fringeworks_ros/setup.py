"""Package of the ROS 2 node; built by colcon."""

from setuptools import setup

NAME = "fringeworks_ros"

setup(
    name=NAME,
    version="0.1.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", ["launch/scanner.launch.py"]),
        (f"share/{NAME}/config", ["config/scanner.yaml"]),
    ],
    # The same version of the library, from PyPI or from this repository: pip install fringeworks.
    install_requires=["setuptools", "fringeworks[calibration]==0.1.0"],
    zip_safe=True,
    maintainer="The fringeworks authors",
    description="A fringe projection scanner as a ROS 2 node.",
    license="MIT",
    entry_points={"console_scripts": [f"scanner = {NAME}.node:main"]},
)
