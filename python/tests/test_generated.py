"""The generated files are those of the programs beside them."""

import importlib.util
from pathlib import Path

import rcc
from rcc._io import run


def test_the_generated_files_are_current(cell_name):
    spec = importlib.util.spec_from_file_location("generate", Path(__file__).parents[1] / "generate.py")
    generate = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(generate)
    with rcc.connect(cell_name) as cell:
        answers = [run(cell._inner._ask("GET", path)) for path in ("/openapi.json", "/primitives")]
    stale = [path.name for path, text in generate.files(*answers).items() if path.read_text() != text]
    assert not stale, "run generate.py with the answers of GET /openapi.json and GET /primitives"


def test_every_schema_and_primitive_is_there(cell):
    from rcc._generated import api, catalogue

    assert api.CommandView.__required_keys__ >= {"id", "net", "state"}
    assert issubclass(catalogue.LinearMotion, rcc.Block)
    assert "flange pose" in rcc.Net.LinearMotion.__doc__
