"""The only modules that open files; read ``recordings`` first, then ``model_file``."""
