"""Links and quoted messages of the documents: what they name is there."""

import ast
from functools import cache
from itertools import chain
from pathlib import Path
import re

import pytest
import yaml

ROOT = Path(__file__).parents[1]
FOLDERS = ('.', 'docs', 'data/keller_pa10', '.github/ISSUE_TEMPLATE')
DOCUMENTS = sorted(path for folder in FOLDERS for path in (ROOT / folder).glob('*.md'))
CODE = [
    'wrist_ft_comp', 'bench', 'docs', 'examples', 'test', 'requirements', 'config', 'data', '.ci',
    '.github',
]  # fmt: skip
every_document = pytest.mark.parametrize('document', DOCUMENTS, ids=str)


def outside_blocks(document):
    return re.sub(r'^```.*?^```', '', document.read_text('utf-8'), flags=re.M | re.S)


def anchors(document):
    """What links may name behind a #: headings of a document, as GitHub writes them."""
    headings = re.findall(r'^#+ (.+)$', outside_blocks(document), re.M)
    words = (re.sub(r'[^\w\- ]', '', heading.lower()) for heading in headings)
    return {text.replace(' ', '-') for text in words}


@every_document
def test_links_lead_somewhere(document):
    for target in re.findall(r'\]\(([^)]+)\)', outside_blocks(document)):
        if not target.startswith(('http:', 'https:', 'mailto:')):
            file, _, anchor = target.partition('#')
            path = document.parent / file if file else document
            assert path.exists(), target
            assert not anchor or anchor in anchors(path), target


@every_document
def test_files_and_targets_of_make_that_are_named_exist(document):
    for name in re.findall(r'`([\w./-]+/[\w.-]+\.?\w*)`', outside_blocks(document)):
        first = name.split('/')[0]
        if first in CODE:
            assert (ROOT / name).exists(), name
        elif (ROOT / 'wrist_ft_comp' / first).is_dir() and name.endswith('.py'):
            assert (ROOT / 'wrist_ft_comp' / name).exists(), name
    makefile = (ROOT / 'Makefile').read_text('utf-8')
    for target in re.findall(r'`make ([\w-]+)', document.read_text('utf-8')):
        assert re.search(rf'^{target}:', makefile, re.M), target


def test_architecture_names_where_things_are():
    text = (ROOT / 'docs/architecture.md').read_text('utf-8')
    places = re.findall(r'^\| .+ \| `([\w/]+\.py)` \| `([\w.]+)` \|$', text, re.M)
    assert len(places) > 50
    for file, definition in places:
        folder = ROOT / 'wrist_ft_comp' if (ROOT / 'wrist_ft_comp' / file).exists() else ROOT
        code = (folder / file).read_text('utf-8')
        for name in definition.split('.'):
            assert re.search(rf'(?:def|class) {name}\b', code), (file, name)


@every_document
def test_commands_stand_in_documents_that_are_walked(document):
    walks = ''.join(path.read_text('utf-8') for path in ROOT.glob('test/node/documents/test_*.py'))
    name = document.relative_to(ROOT).as_posix()
    assert '```sh\n' not in document.read_text('utf-8') or f"'{name}'" in walks


def with_holes(node):
    """A string of the code in one line, with … for what is filled in."""
    if isinstance(node, ast.JoinedStr):
        return ''.join(map(with_holes, node.values))
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        return with_holes(node.left) + with_holes(node.right)
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    return '…'


def in_one_line(text):
    """White space as one blank, and holes beside each other as one."""
    return re.sub(r'…( ?…)*', '…', ' '.join(text.split()))


@cache
def messages():
    """Every string of the package: its place, itself in one line, and within what it stands."""
    return tuple(
        (f'{path.relative_to(ROOT)}:{child.lineno}', in_one_line(with_holes(child)), type(node))
        for path in sorted((ROOT / 'wrist_ft_comp').rglob('*.py'))
        for node in ast.walk(ast.parse(path.read_text('utf-8')))
        for child in ast.iter_child_nodes(node)
        if isinstance(child, (ast.JoinedStr, ast.BinOp, ast.Constant))
    )


def test_every_sentence_is_short_enough_to_be_read_aloud():
    """A person reads the list; what has more than 45 words has two thoughts."""
    parts = ast.JoinedStr, ast.FormattedValue, ast.BinOp, ast.Expr  # and docstrings
    said = [(place, text) for place, text, within in messages() if not issubclass(within, parts)]
    said = [one for one in said if re.search(r'\w+ \S+ \S+ .*[.?]$', one[1])]
    assert len(said) > 300
    lines = [f'{place}\n    {text}' for place, text in said]
    (ROOT / 'build').mkdir(exist_ok=True)
    (ROOT / 'build/messages.txt').write_text('\n'.join(lines), 'utf-8')
    sentences = [sentence for _, text in said for sentence in re.split(r'[.?:;] ', text)]
    long = [sentence for sentence in sentences if sentence.count(' ') > 44]
    assert long == []


def quoted():
    """Messages in the first cells of the tables, where `<br>` stands between two of them."""
    text = (ROOT / 'docs/troubleshooting.md').read_text('utf-8')
    cells = re.findall(r'^\| ([^|*]+) \|', text, re.M)
    quotes = chain.from_iterable(cell.split(' <br> ') for cell in cells if cell != 'it says')
    return [in_one_line(quote) for quote in quotes]


@pytest.mark.parametrize('message', quoted())
def test_a_quoted_message_is_one_of_the_code(message):
    """Holes may stand for more in the document than in the code, never for less."""
    parts = [part.strip(' .') for part in message.split('…') if part.strip(' .,;')]
    pattern = '.*'.join(map(re.escape, parts))
    assert any(re.search(pattern, text) for _, text, _ in messages()), message


def test_hooks_before_a_commit_run_what_make_lint_runs():
    config = yaml.safe_load((ROOT / '.pre-commit-config.yaml').read_text('utf-8'))
    (repository,) = config['repos']
    assert repository['repo'] == 'local', "the linters are the environment's own"
    hooks = [hook['entry'].removeprefix('.venv/bin/') for hook in repository['hooks']]
    makefile = (ROOT / 'Makefile').read_text('utf-8')
    recipe = re.search(r'^lint:.*\n((?:\t.*\n)+)', makefile, re.M)
    assert recipe is not None
    assert hooks == re.findall(r'\$\(BIN\)/(.*)', recipe[1])


def test_the_figures_of_the_readme_stand_in_accuracy():
    names = 'README.md', 'docs/accuracy.md'
    readme, accuracy = ((ROOT / name).read_text('utf-8') for name in names)
    table = readme.partition('| drift that is left')[2].partition('\n\n')[0]
    shares, errors = (re.findall(rf'([\d.]+) {unit} (?=\|)', table) for unit in ('%', 'N'))
    texts = [f'{float(share) / 100:.3f}' for share in shares if share != '100']
    for text in (*texts, *(f'{error} (' for error in errors)):
        assert text in accuracy, text
