# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What package.xml, setup.py, the launch file and the parameter file say agrees."""

from __future__ import annotations

import ast
import re
import shutil
import subprocess
import sys
import tomllib
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import yaml

from tools.licence import NOTICE, lacking

ROOT = Path(__file__).resolve().parents[2]
MAKEFILE = ROOT / "Makefile"


def setup_text() -> str:
    return (ROOT / "setup.py").read_text()


def test_name_version_and_licence_agree():
    package = ElementTree.parse(ROOT / "package.xml").getroot()
    for field in ("name", "version", "license"):
        value = package.findtext(field)
        assert f'{field}="{value}"' in setup_text()
    assert package.get("format") == "3"
    assert package.findtext("export/build_type") == "ament_python"


def test_the_repository_is_named_in_package_xml_alone(tmp_path):
    """setup.py and `make docs` read it there; what cannot read names the same, or none."""
    package = (ROOT / "package.xml").read_text()
    named = ElementTree.fromstring(package).findtext("url[@type='repository']")
    other = ElementTree.parse(ROOT / "interfaces" / "package.xml").getroot()
    assert other.findtext("url[@type='repository']") == named
    assert yaml.safe_load((ROOT / "CITATION.cff").read_text()).get("repository-code") == named

    known = "https://rb-sim.org/repository"
    url = f'<url type="repository">{known}</url>'
    text = re.sub(r'  <url type="repository">.*</url>\n', "", package)
    (tmp_path / "package.xml").write_text(text.replace("  <license", f"  {url}\n  <license", 1))
    shutil.copy(ROOT / "setup.py", tmp_path)
    (of_docs,) = re.findall(
        r"REPOSITORY_URL \?= \$\(shell (.*)\)$", MAKEFILE.read_text(), re.MULTILINE
    )
    for command in ([sys.executable, "setup.py", "--url"], ["bash", "-c", of_docs]):
        asked = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
        assert asked.stdout.split()[-1] == known


def test_maintainers_are_those_of_setup_with_an_address_that_the_schema_takes():
    """EmailType of package_common.xsd; names of example domains are nobody's."""
    for path in ("package.xml", "interfaces/package.xml"):
        (maintainer,) = ElementTree.parse(ROOT / path).getroot().findall("maintainer")
        assert f'maintainer="{maintainer.text}"' in setup_text()
        address = maintainer.get("email", "")
        name = r"[-\w%+]+(\.[-\w%+]+)*"
        assert re.fullmatch(rf"{name}@[-a-zA-Z0-9%]+(\.[-a-zA-Z0-9%]+)*\.[a-zA-Z]{{2,}}", address)
        assert not re.search(r"example|invalid|test$", address)


def test_each_source_file_begins_with_the_notice_of_the_licence():
    """By `python -m tools.licence`; ament_copyright compares words."""
    assert lacking() == []
    words = " ".join(NOTICE.split())
    assert re.match(r"Copyright \d{4} rb_sim contributors Licensed under the Apache License", words)
    appendix = " ".join((ROOT / "LICENSE").read_text().split())
    assert words.partition("contributors ")[2] in appendix


def test_licence_is_apache():
    text = (ROOT / "LICENSE").read_text()
    assert "Apache License" in text and "Version 2.0" in text and "APPENDIX" in text


def test_every_floor_is_the_lower_bound_of_setup():
    floors = dict(
        line.split("==")
        for line in (ROOT / "requirements" / "floor.txt").read_text().splitlines()
        if "==" in line
    )
    bounds = ast.literal_eval(re.search(r"install_requires=(\[.*?\])", setup_text(), re.S)[1])
    pinned = {name.lower(): version for name, version in floors.items()}
    for requirement in bounds:
        name, lowest = requirement.split(",")[0].split(">=")
        assert (pinned[name] + ".").startswith(lowest + ".")


def test_package_xml_and_pixi_have_the_bounds_of_setup():
    bounds = ast.literal_eval(re.search(r"install_requires=(\[.*?\])", setup_text(), re.S)[1])
    wanted = {}
    for requirement in bounds:
        name, _, rest = requirement.partition(">=")
        wanted[name] = rest
    package = ElementTree.parse(ROOT / "package.xml").getroot()
    keys = {"pyyaml": "yaml"}
    declared = {one.text: one.get("version_gte") for one in package.iter("exec_depend")}
    for name, rest in wanted.items():
        key = f"python3-{keys.get(name, name)}"
        assert declared.get(key, rest.split(",")[0]) == rest.split(",")[0]
    assert "python3-pydantic" in declared
    pixi = tomllib.loads((ROOT / "pixi.toml").read_text())
    names = {"matplotlib": "matplotlib-base", "zstandard": "python-zstandard"}
    given = pixi["dependencies"] | pixi["pypi-dependencies"]
    for name, rest in wanted.items():
        assert given[names.get(name, name)] == f">={rest}"
    assert given["rb_sim"] == {"path": ".", "editable": True}


def test_package_xml_names_every_ros_package_that_is_imported():
    """Those of rb_sim's own and others' messages that a node does without are not among them."""
    without = {"rb_sim_interfaces", "simulation_interfaces"}
    text = "".join(path.read_text() for path in (ROOT / "rb_sim/ros").glob("*.py"))
    found = re.findall(
        r'(?:from |import |import_module\(")([a-z_]+_(?:msgs|srvs|interfaces))\.', text
    )
    package = ElementTree.parse(ROOT / "package.xml").getroot()
    declared = {one.text for one in package.iter("exec_depend")}
    assert set(found) - without <= declared


def test_launch_file_starts_the_installed_executable_with_the_installed_files():
    path = ROOT / "launch" / "rb_sim.launch.py"
    tree = ast.parse(path.read_text())
    compile(tree, str(path), "exec")
    functions = [node.name for node in tree.body if isinstance(node, ast.FunctionDef)]
    assert functions == ["generate_launch_description"]
    texts = {node.value for node in ast.walk(tree) if isinstance(node, ast.Constant)}
    assert "rb_sim_node = rb_sim.ros.main:main" in setup_text() and "rb_sim_node" in texts
    configs = {text for text in texts if isinstance(text, str) and text.endswith(".yaml")}
    assert configs and all((ROOT / "config" / name).is_file() for name in configs)


def test_parameter_file_is_a_ros_parameter_file():
    document = yaml.safe_load((ROOT / "config" / "rb_sim_node.params.yaml").read_text())
    assert list(document) == ["/**"] and list(document["/**"]) == ["ros__parameters"]
