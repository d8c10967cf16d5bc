"""The files of reports and pictures, and how they are recognized."""

from wrist_ft_comp.stored.documents import Output

#: What every page names as its generator, by which it is known again.
GENERATOR = 'wrist_ft_comp report'
#: The same of every PNG.
PAINTER = 'wrist_ft_comp picture'

REPORT = Output(name='report', says=f'content="{GENERATOR}"', endings='.html .htm')
PICTURE = Output(name='picture', says=f'Software\0{PAINTER}', endings='.png')
