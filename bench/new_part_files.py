"""What a part of one's own takes, as entries of build/bench.json.

  new_part_files        files that one writes or touches for a new controller: what `frankapy new controller` writes, in an
                        empty folder outside the repository, without the README, which nothing needs
  tutorial_part_lines   lines of C++ of the longest part of docs/your-own-part.md
"""

import json
import re
import tempfile
from pathlib import Path

from frankapy.new_part import write_project

TUTORIAL = Path(__file__).resolve().parent.parent / "docs" / "your-own-part.md"


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        write_project("controller", "my_controller", Path(folder))
        files = [path for path in Path(folder).rglob("*") if path.is_file() and path.name != "README.md"]
    blocks = re.findall(r"^```cpp (\S+)\n(.*?)^```", TUTORIAL.read_text(), re.MULTILINE | re.DOTALL)
    lines = max(text.count("\n") for name, text in blocks if not name.startswith("test_"))
    print(json.dumps({"new_part_files": len(files), "tutorial_part_lines": lines}))


if __name__ == "__main__":
    main()
