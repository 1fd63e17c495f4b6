"""Builds the distribution: the packages, and `etc/` as `dsr/etc`, where an installed `dsr` finds it."""

from setuptools import find_packages, setup

OWN = ("dsr", "agents", "simulation_handler", "surprise", "planner", "benchmarks")

setup(
    packages=[*find_packages(include=[f"{name}*" for name in OWN]), "dsr.etc"],
    package_dir={"dsr.etc": "etc"},
    package_data={
        "dsr.etc": ["**/*"],
        "benchmarks.model": ["*.tla"],
        "benchmarks.compiled": ["*.cpp", "*.hpp"],
        **{name: ["py.typed"] for name in OWN},
    },
)
