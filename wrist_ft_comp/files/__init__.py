"""
The only modules that open files. Nothing here computes, and nothing else here knows a format.

Read ``recordings`` first: ``read_recording``, ``rewrite_recording``, ``describe_recording`` of
every kind, which ``csv_file``, ``chamber_table`` and ``bags`` read. What messages hold is for
``cdr`` (a header and doubles) and ``cdr_fields`` (any type). Then ``model_file`` (``load_model``,
``save_model``), ``payload_file`` beside it, ``state_file`` and ``model_store``, a node's folder;
``documents`` is what these share. Between processes travel ``job_request`` and ``demo_log``.
"""
