"""Checks OpenDRIVE files with ASAM's checker, and prints its remarks by rule."""

import json
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from qc_baselib import Result  # pyright: ignore[reportMissingImports]

CONFIG = """<Config>
  <Param name="InputFile" value="{file}"/>
  <CheckerBundle application="xodrBundle">
    <Param name="resultFile" value="{result}"/>
  </CheckerBundle>
</Config>
"""

found = {}
for name in sys.argv[1:]:
    with TemporaryDirectory() as folder:
        config, output = Path(folder, "config.xml"), Path(folder, "result.xqar")
        config.write_text(CONFIG.format(file=Path(name).resolve(), result=output))
        command = [sys.executable, "-m", "qc_opendrive.main", "-c", config]
        subprocess.run(command, check=True, capture_output=True)
        result = Result()
        result.load_from_file(str(output))
        found[Path(name).name] = [
            [issue.rule_uid, issue.description]
            for bundle in result.get_checker_bundle_names()
            for checker in result.get_checker_results(bundle)
            for issue in checker.issues
        ]
print(json.dumps(found))
