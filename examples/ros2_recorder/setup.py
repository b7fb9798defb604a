"""The package as `colcon build` installs it."""

from setuptools import setup

NAME = "armgap_recorder"

setup(
    name=NAME,
    version="0.1.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
    ],
    install_requires=["setuptools"],
    license="BSD-3-Clause",
    entry_points={"console_scripts": [f"recorder = {NAME}.node:main"]},
)
