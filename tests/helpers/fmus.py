"""Builds the FMUs of the tests: the C tank of `peers/fmu_tank.c` for FMI 2.0 and 3.0, and models of PythonFMU."""

from __future__ import annotations

import shutil
import subprocess
import sys
import zipfile
from importlib.util import find_spec
from pathlib import Path
from xml.sax.saxutils import quoteattr

import pytest

Missing = pytest.skip.Exception
"""A test that builds an FMU is skipped without what that takes; anyone else may catch it."""
SOURCE = Path(__file__).parent / "peers" / "fmu_tank.c"
LIBRARY = {"linux": ".so", "darwin": ".dylib", "win32": ".dll"}

# name, value reference, type of FMI 2.0, type of FMI 3.0, causality, variability, start
VARIABLES = [
    ("time", 0, "Real", "Float64", "independent", "continuous", None),
    ("inflow", 1, "Real", "Float64", "input", "continuous", "0"),
    ("time_constant", 2, "Real", "Float64", "parameter", "fixed", "2"),
    ("gain", 3, "Real", "Float64", "parameter", "tunable", "1"),
    ("tank.level", 4, "Real", "Float64", "output", "continuous", "0"),
    ("count", 5, "Integer", "Int32", "input", "discrete", "0"),
    ("doubled", 6, "Integer", "Int32", "output", "discrete", None),
    ("enable", 7, "Boolean", "Boolean", "input", "discrete", "false"),
    ("enabled", 8, "Boolean", "Boolean", "output", "discrete", None),
    ("mode", 9, "Enumeration", "Enumeration", "input", "discrete", "1"),
    ("mode_used", 10, "Enumeration", "Enumeration", "output", "discrete", None),
    ("fault", 11, "Integer", "Int32", "parameter", "tunable", "0"),
    ("odd", 12, "Real", "Float64", "output", "continuous", None),
    ("steps", 13, "Integer", "Int32", "output", "discrete", None),
    ("broken", 25, "Real", "Float64", "input", "continuous", "0"),
    ("label", 14, "String", "String", "parameter", "fixed", "tank"),
    ("text_out", 26, "String", "String", "output", "discrete", None),
]
"""Of both versions; "tank.level" starts exactly where it is told to, the model refuses any value of "broken"."""
ONLY_3 = [
    ("small", 15, "Int8", "input", "0"),
    ("small_out", 16, "Int8", "output", None),
    ("big", 17, "UInt64", "input", "0"),
    ("big_out", 18, "UInt64", "output", None),
    ("single", 19, "Float32", "input", "0"),
    ("single_out", 20, "Float32", "output", None),
    ("wide", 21, "Int64", "input", "0"),
    ("wide_out", 22, "Int64", "output", None),
    ("word", 23, "UInt16", "input", "0"),
    ("word_out", 24, "UInt16", "output", None),
    ("data_out", 27, "Binary", "output", None),
    ("rows_out", 28, "Float64", "output", None),
    ("rows", 33, "Float64", "input", "0 0 0 0 0 0"),
    ("byte", 29, "UInt8", "input", "0"),
    ("byte_out", 30, "UInt8", "output", None),
    ("dword", 31, "UInt32", "input", "0"),
    ("dword_out", 32, "UInt32", "output", None),
]


PYTHON_TANK = '''
from pythonfmu import Boolean, Fmi2Causality, Fmi2Slave, Fmi2Variability, Integer, Real


class PythonTank(Fmi2Slave):
    """level' = (inflow - level) / time_constant, by steps of Euler."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.inflow, self.level, self.time_constant, self.open, self.steps = 0.0, 0.0, 2.0, False, 0
        self.register_variable(Real("inflow", causality=Fmi2Causality.input))
        self.register_variable(Boolean("open", causality=Fmi2Causality.input))
        self.register_variable(Real("time_constant", causality=Fmi2Causality.parameter,
                                    variability=Fmi2Variability.tunable))
        self.register_variable(Real("level", causality=Fmi2Causality.output))
        self.register_variable(Integer("steps", causality=Fmi2Causality.output))

    def do_step(self, time, size):
        if self.level > 3.0:
            raise ValueError("the tank overflows")
        self.level += size * ((self.inflow if self.open else 0.0) - self.level) / self.time_constant
        self.steps += 1
        return True
'''

PYTHON_LOOPS = """
from pythonfmu import Boolean, Fmi2Causality, Fmi2Slave, Fmi2Variability, Real


class PythonLoops(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.enable, self.level = False, 0.0
        discrete = {"variability": Fmi2Variability.discrete}
        self.register_variable(Boolean("enable", causality=Fmi2Causality.input, **discrete))
        self.register_variable(
            Boolean("enabled", causality=Fmi2Causality.output, getter=lambda: self.enable, **discrete))
        self.register_variable(Real("level", causality=Fmi2Causality.input))
        self.register_variable(Real("level_out", causality=Fmi2Causality.output, getter=lambda: self.level))

    def do_step(self, time, size):
        return True
"""


def tank_fmu(folder: Path, version: int, *, extra: str = "", platform: str = "", attributes: str = "") -> Path:
    """`tank2.fmu` or `tank3.fmu` in the folder; skips the test without a C compiler. `extra` is put among the
    variables, `attributes` into the element CoSimulation; `platform` is the folder of its code."""
    fmpy = pytest.importorskip("fmpy", reason="the driver fmu needs FMPy")
    library = _compiled(folder, version, Path(fmpy.__file__).parent / "c-code")
    file = folder / f"tank{version}{platform}.fmu"
    where = platform or (fmpy.platform if version == 2 else fmpy.platform_tuple)
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("modelDescription.xml", (_xml2 if version == 2 else _xml3)(extra, attributes))
        archive.write(library, f"binaries/{where}/tank{library.suffix}")
        archive.writestr("resources/data.txt", "1")
    return file


def python_fmu(folder: Path, source: str, name: str) -> Path:
    """An FMU that PythonFMU makes of this module. In a process of its own: a model of PythonFMU that has run in this
    one has left its own copy of PythonFMU among the modules."""
    if find_spec("pythonfmu") is None:
        raise Missing("PythonFMU is not installed")
    (folder / f"{name}.py").write_text(source)
    built = folder / f"built-{name}"
    words = [sys.executable, "-m", "pythonfmu", "build", "-f", f"{name}.py", "-d", str(built)]
    subprocess.run(words, cwd=folder, check=True)
    (file,) = built.glob("*.fmu")
    return file


def _compiled(folder: Path, version: int, headers: Path) -> Path:
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        pytest.skip("the FMU of the tests needs a C compiler")
    library = folder / f"tank{version}{LIBRARY.get(sys.platform, '.so')}"
    if not library.exists():
        words = [compiler, "-shared", "-fPIC", "-O1", f"-DFMI={version}", f"-I{headers}", str(SOURCE), "-lm"]
        subprocess.run([*words, "-o", str(library)], check=True)
    return library


def _xml2(extra: str, attributes: str) -> str:
    lines = []
    for name, reference, kind, _, causality, variability, start in VARIABLES:
        initial = ' initial="exact"' if name == "tank.level" else ""
        given = f" start={quoteattr(start)}" if start is not None else ""
        declared = ' declaredType="Mode"' if kind == "Enumeration" else ""
        lines.append(f'<ScalarVariable name="{name}" valueReference="{reference}" causality="{causality}" '
                     f'variability="{variability}"{initial}><{kind}{declared}{given}/></ScalarVariable>')  # fmt: skip
    outputs = [i for i, each in enumerate(VARIABLES, 1) if each[4] == "output"]
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="Tank" guid="{{tank}}">
<CoSimulation modelIdentifier="tank" canHandleVariableCommunicationStepSize="true" {attributes}/>
<TypeDefinitions><SimpleType name="Mode"><Enumeration><Item name="slow" value="1"/><Item name="fast" value="2"/>
</Enumeration></SimpleType></TypeDefinitions>
<LogCategories><Category name="logStatusError"/></LogCategories>
<DefaultExperiment startTime="0" stepSize="0.1"/>
<ModelVariables>{"".join(lines)}{extra}</ModelVariables>
<ModelStructure><Outputs>{"".join(f'<Unknown index="{i}"/>' for i in outputs)}</Outputs></ModelStructure>
</fmiModelDescription>"""


def _xml3(extra: str, attributes: str) -> str:
    lines, outputs = [], []
    rows = [(name, ref, kind, causality, variability, start) for name, ref, _, kind, causality, variability, start
            in VARIABLES]  # fmt: skip
    rows += [(name, ref, kind, causality, "continuous" if kind == "Float32" else "discrete", start)
             for name, ref, kind, causality, start in ONLY_3]  # fmt: skip
    for name, reference, kind, causality, variability, start in rows:
        head = f'<{kind} name="{name}" valueReference="{reference}" causality="{causality}" variability="{variability}"'
        head += ' declaredType="Mode"' if kind == "Enumeration" else ""
        if kind == "String" and start is not None:
            lines.append(f'{head}><Start value="{start}"/></String>')
            continue
        outputs += [reference] if causality == "output" else []
        if name in ("rows", "rows_out"):
            given = f' start="{start}"' if start is not None else ""
            lines.append(f'{head}{given}><Dimension start="2"/><Dimension start="3"/></Float64>')
            continue
        head += ' initial="exact"' if name == "tank.level" else ""
        lines.append(f"{head}{f' start={quoteattr(start)}' if start is not None else ''}/>")
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="Tank" instantiationToken="{{tank}}">
<CoSimulation modelIdentifier="tank" canHandleVariableCommunicationStepSize="true" {attributes}/>
<TypeDefinitions><EnumerationType name="Mode"><Item name="slow" value="1"/><Item name="fast" value="2"/>
</EnumerationType></TypeDefinitions>
<LogCategories><Category name="logStatusError"/></LogCategories>
<DefaultExperiment startTime="0" stepSize="0.1"/>
<ModelVariables>{"".join(lines)}{extra}</ModelVariables>
<ModelStructure>{"".join(f'<Output valueReference="{i}"/>' for i in outputs)}</ModelStructure>
</fmiModelDescription>"""
