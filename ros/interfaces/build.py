"""Build the interfaces without wheels into the environment of this Python.

The wheels of rclpy for tests (see kilted.txt) bring the generators of rosidl; cmake and ninja come from pip, the
C++ compiler from the system. On a robot its ROS 2 distribution has these packages.

    pip install -r ros/interfaces/kilted.txt && python ros/interfaces/build.py
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

HERE = Path(__file__).parent
PACKAGES = {
    "control_msgs": ("builtin_interfaces", "geometry_msgs"),
    "hri_actions_msgs": ("geometry_msgs",),
    "hri_msgs": ("std_msgs",),
    "tf2_msgs": ("geometry_msgs",),
    "vision_msgs": ("geometry_msgs", "std_msgs"),
}
CMAKE = """cmake_minimum_required(VERSION 3.20)
project({name})
find_package(ament_cmake REQUIRED)
find_package(rosidl_default_generators REQUIRED)
{find}
rosidl_generate_interfaces({name} {files} DEPENDENCIES {dependencies})
# The wheels contain paths of their build folder; cmake refuses nonexistent paths.
foreach(package action_msgs builtin_interfaces geometry_msgs service_msgs std_msgs unique_identifier_msgs)
  set(target ${{package}}::${{package}}__rosidl_generator_py)
  if(TARGET ${{target}})
    get_target_property(folders ${{target}} INTERFACE_INCLUDE_DIRECTORIES)
    list(FILTER folders EXCLUDE REGEX "^/opt/python/")
    set_target_properties(${{target}} PROPERTIES INTERFACE_INCLUDE_DIRECTORIES "${{folders}}")
  endif()
endforeach()
ament_package()
"""
XML = """<?xml version="1.0"?>
<package format="3"><name>{name}</name><version>0.0.1</version><description>Of tests</description>
<maintainer email="none@example.org">gazempc</maintainer><license>MIT</license>
<buildtool_depend>ament_cmake</buildtool_depend><depend>rosidl_default_generators</depend>{depend}
<member_of_group>rosidl_interface_packages</member_of_group>
<export><build_type>ament_cmake</build_type></export></package>
"""


def build(name: str, dependencies: tuple[str, ...], work: Path) -> None:
    """Build and install one package."""
    source, made = work / name, work / f"{name}_build"
    shutil.copytree(HERE / name, source)
    files = sorted(str(path.relative_to(source)) for path in source.rglob("*.*"))
    find = "\n".join(f"find_package({each} REQUIRED)" for each in dependencies)
    text = CMAKE.format(name=name, files=" ".join(files), find=find, dependencies=" ".join(dependencies))
    (source / "CMakeLists.txt").write_text(text)
    depend = "".join(f"<depend>{each}</depend>" for each in dependencies)
    (source / "package.xml").write_text(XML.format(name=name, depend=depend))
    environment = os.environ | {
        "AMENT_PREFIX_PATH": sys.prefix,
        "PATH": f"{Path(sys.prefix) / 'bin'}:{os.environ['PATH']}",
    }
    options = [f"-D{key}={value}" for key, value in {
        "CMAKE_PREFIX_PATH": sys.prefix, "CMAKE_INSTALL_PREFIX": sys.prefix, "BUILD_TESTING": "OFF",
        "Python3_EXECUTABLE": sys.executable, "CMAKE_BUILD_TYPE": "Release",
        "CMAKE_CXX_FLAGS": "-O0", "CMAKE_C_FLAGS": "-O0",
    }.items()]  # fmt: skip
    for command in (
        ["cmake", "-G", "Ninja", "-S", str(source), "-B", str(made), *options],
        ["cmake", "--build", str(made), "--target", "install"],
    ):
        result = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
        if result.returncode:
            raise SystemExit(f"{' '.join(command)}\n{result.stdout[-4000:]}\n{result.stderr[-4000:]}")


def main() -> None:
    """Build all packages."""
    with tempfile.TemporaryDirectory() as work, ThreadPoolExecutor(os.cpu_count()) as pool:
        list(pool.map(lambda each: build(*each, Path(work)), PACKAGES.items()))


if __name__ == "__main__":
    main()
