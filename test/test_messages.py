"""Every sentence that the package says to people, in one file for reading aloud."""

import ast
from pathlib import Path
import re

ROOT = Path(__file__).parents[1]
#: Where they are written to, by file and line; a person reads them.
LIST = ROOT / 'build/messages.txt'
#: Most words of a sentence: what is longer has two thoughts.
MOST_WORDS = 45


def words_of(node):
    """Put a text, an f-string or a sum of them together; what is filled in becomes its name."""
    if isinstance(node, ast.Constant):
        return node.value if isinstance(node.value, str) else ''
    if isinstance(node, ast.JoinedStr):
        return ''.join(map(words_of, node.values))
    if isinstance(node, ast.FormattedValue):
        return f'<{ast.unparse(node.value)}>'
    return ''


def messages():
    """Yield place and text of what reads like a sentence and is no docstring."""
    for path in sorted((ROOT / 'wrist_ft_comp').rglob('*.py')):
        tree = ast.parse(path.read_text('utf-8'))
        parents = {child: node for node in ast.walk(tree) for child in ast.iter_child_nodes(node)}
        for node in ast.walk(tree):
            inside = isinstance(parents.get(node), ast.JoinedStr | ast.FormattedValue | ast.Expr)
            text = ' '.join(words_of(node).split())
            if not inside and re.search(r'\w+ \S+ \S+ .*[.?]$', text):
                yield f'{path.relative_to(ROOT)}:{node.lineno}', text


def test_every_sentence_is_short_enough_to_be_read_aloud():
    said = list(messages())
    assert len(said) > 300
    LIST.parent.mkdir(exist_ok=True)
    LIST.write_text('\n'.join(f'{place}\n    {text}' for place, text in said), 'utf-8')
    long = [
        (place, sentence)
        for place, text in said
        for sentence in re.split(r'[.?:;] ', re.sub(r'<.*?>', 'name', text))
        if len(sentence.split()) > MOST_WORDS
    ]
    assert long == []
