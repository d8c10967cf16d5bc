"""Version 0.1.0 in a folder of its own, to be measured beside the present one in the same run."""

import io
from pathlib import Path
import subprocess
import tarfile

VERSION, COMMIT = '0.1.0', '6587219618bfc602db6fcb0fa897c57931f6673a'
ROOT = Path(__file__).resolve().parent.parent


def baseline() -> Path:
    """Give the folder to put on PYTHONPATH; it is made once, from the repository's history."""
    folder = ROOT / f'build/v{VERSION}'
    if not (folder / 'wrist_ft_comp').is_dir():
        words = ['git', 'archive', COMMIT]
        archive = subprocess.run(words, cwd=ROOT, check=True, capture_output=True).stdout
        with tarfile.open(fileobj=io.BytesIO(archive)) as files:
            files.extractall(folder, filter='data')
    return folder
