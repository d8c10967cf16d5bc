"""Our own files; read ``own_file`` first, then ``model_file``."""
