#!/usr/bin/env bash
# photutils 3.0.0 reads the list of files of every installed package whenever it is imported.
#
# Expected: an import costs what the package and what it needs cost, in any environment.
# Seen: `photutils.utils._optional_deps` asks `importlib.metadata.packages_distributions()` for its own name, which opens
# `top_level.txt` or `RECORD` of every distribution on the path, and parses it. Beside 400 packages of 500 files each,
# `import photutils.aperture` opens 1200 of their files and takes 1.7 s instead of 0.9; the answer is "photutils" either way.
# photutils 2.3.0 opens none of them and takes 0.8 s in both.
# Who meets it: commands that start photutils for one circle, in the large shared environments of observatories.
set -euo pipefail
folder="$(mktemp -d)"
trap 'rm -rf "$folder"' EXIT
python3 - "$folder/many" <<'PYTHON'
import pathlib
import sys

for number in range(400):
    place = pathlib.Path(sys.argv[1], f"package{number}-1.0.dist-info")
    place.mkdir(parents=True)
    (place / "METADATA").write_text(f"Metadata-Version: 2.1\nName: package{number}\nVersion: 1.0\n")
    (place / "RECORD").write_text("".join(f"package{number}/part{part}.py,,\n" for part in range(500)))
PYTHON
cat >"$folder/count.py" <<'PYTHON'
import sys
import time

opened = 0


def hook(event, arguments):
    global opened
    opened += event == "open" and "/many/package" in str(arguments[0])


sys.addaudithook(hook)
began = time.process_time()
import photutils.aperture  # noqa: E402

print(photutils.__version__, opened, f"{time.process_time() - began:.2f}")
PYTHON
for version in 2.3.0 3.0.0; do
  python3 -m venv "$folder/$version"
  "$folder/$version/bin/pip" install --quiet --disable-pip-version-check "photutils==$version" numpy==2.4.6
  "$folder/$version/bin/python" "$folder/count.py" >/dev/null # compiles the modules once
  read -r _ _ alone < <("$folder/$version/bin/python" "$folder/count.py")
  read -r name files beside < <(PYTHONPATH="$folder/many" "$folder/$version/bin/python" "$folder/count.py")
  echo "photutils $name: $alone s alone, $beside s beside 400 packages, of which it opened $files files"
  case "$version" in
    2.3.0) [ "$files" -eq 0 ] ;;
    3.0.0) [ "$files" -ge 400 ] || { echo "the behaviour has changed: other packages are left alone" >&2; exit 1; } ;;
  esac
done
