"""Our own files; read ``safe_file`` first, then ``model_file``."""
