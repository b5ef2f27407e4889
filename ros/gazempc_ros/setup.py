"""The ament_python package `gazempc_ros`; gazempc is installed first, see docs/ros2.md."""

from pathlib import Path

from setuptools import setup

NAME = "gazempc_ros"

setup(
    name=NAME,
    version="0.2.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        *((f"share/{NAME}/{folder}", [str(p) for p in Path(folder).iterdir()]) for folder in ("launch", "config")),
    ],
    install_requires=["setuptools", "gazempc"],
    entry_points={"console_scripts": ["gaze = gazempc_ros.gaze:main", "walk = gazempc_ros.walk:main"]},
)
