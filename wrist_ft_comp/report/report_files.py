"""The files of reports and pictures, and how each begins, by which it is known again."""

from wrist_ft_comp.stored.own_file import Output

#: What every page names as its generator, and every PNG as its software.
GENERATOR, PAINTER = 'wrist_ft_comp report', 'wrist_ft_comp picture'

REPORT = Output(
    name='report', endings='.html .htm',
    begins='<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
    f'<meta name="generator" content="{GENERATOR}">')  # fmt: skip
PICTURE = Output(
    # Header, image header, and the text, before or after the chunk that holds the resolution.
    name='picture', endings='.png',
    begins=rf'\x89PNG\r\n\x1a\n.{{25,80}}tEXtSoftware\x00{PAINTER}')  # fmt: skip
