"""Our own files; read ``documents`` first, then ``model_file``."""
