"""What a person reads: ``evaluation``, ``verdict`` and ``advice``, all in ``report_content``."""
