"""The package for ament_python (colcon) and for pip; the version stands in version.py."""

import re
from pathlib import Path

from setuptools import find_packages, setup

NAME = "herringbone_sim"
SHARE = f"share/{NAME}"
EXECUTABLES = ("simulator", "analyze", "gap", "info", "recover", "replay", "show")
HERE = Path(__file__).resolve().parent


def version() -> str:
    """The version, read without importing what is not yet installed."""
    text = (HERE / NAME / "version.py").read_text(encoding="utf-8")
    found = re.search(r'^VERSION = "(.+)"$', text, re.MULTILINE)
    if found is None:
        raise RuntimeError(f'{NAME}/version.py must hold a line VERSION = "..."')
    return found.group(1)


def requirements(name: str) -> list[str]:
    """Requirements in a file, without comments and references to other files."""
    lines = (HERE / name).read_text(encoding="utf-8").splitlines()
    wanted = (line.partition("#")[0].strip() for line in lines)
    return [line for line in wanted if line and not line.startswith("-")]


def shared(folder: str, *patterns: str) -> tuple[str, list[str]]:
    """Files of a folder as data files of the share folder."""
    files = sorted(path for pattern in patterns for path in (HERE / folder).glob(pattern))
    return f"{SHARE}/{folder}", [str(path.relative_to(HERE)) for path in files]


everything = requirements("requirements.txt")
ros = [line for line in everything if line.startswith("ros-jazzy-")]

setup(
    name=NAME,
    version=version(),
    description="Nonlinear dynamics of a herringbone planetary gear as a ROS 2 node",
    long_description=(HERE / "README.md").read_text(encoding="utf-8"),
    long_description_content_type="text/markdown",
    keywords="gear, planetary gear, nonlinear dynamics, bifurcation, chaos, diagnosis, ROS 2",
    classifiers=[
        "Development Status :: 4 - Beta",
        "Intended Audience :: Science/Research",
        "Operating System :: POSIX :: Linux",
        *(f"Programming Language :: Python :: 3.{minor}" for minor in range(10, 14)),
        "Topic :: Scientific/Engineering :: Physics",
    ],
    license="Apache-2.0",
    python_requires=">=3.10",
    packages=find_packages(exclude=["test", "test.*"]),
    package_data={
        f"{NAME}.diagnosis": ["calibration.json"],
        f"{NAME}.examples.damper": ["weights.json"],
        f"{NAME}.views.pages": ["templates/*"],
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (SHARE, ["package.xml"]),
        shared("launch", "*.launch.py"),
        shared("config", "*.yaml", "*.xml", "*.json"),
    ],
    install_requires=[line for line in everything if line not in ros],
    extras_require={
        "ros": ros,
        "files": requirements("requirements-files.txt"),
        "notebook": requirements("requirements-notebook.txt"),
        "test": requirements("requirements-test.txt"),
    },
    zip_safe=False,
    entry_points={
        "console_scripts": [
            f"{NAME} = {NAME}.__main__:main",
            *(f"{verb} = {NAME}.__main__:executable" for verb in EXECUTABLES),
            f"chaos_control = {NAME}.examples.chaos_control:main",
        ],
    },
)
