"""Where down is: ``source`` hears an IMU or TF, as ``gravity.source`` says, and tells it on."""
