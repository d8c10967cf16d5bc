"""One model of a given structure to given data; read ``axis_data`` first, then ``moments``."""
