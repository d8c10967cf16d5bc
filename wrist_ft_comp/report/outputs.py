"""The files that a report and its pictures are written to, and what tells them from others."""

from wrist_ft_comp.report import GENERATOR, PAINTER
from wrist_ft_comp.stored.documents import Output

REPORT = Output(name='report', says=f'content="{GENERATOR}"', endings='.html .htm')
PICTURE = Output(name='picture', says=f'Software\0{PAINTER}', endings='.png')
