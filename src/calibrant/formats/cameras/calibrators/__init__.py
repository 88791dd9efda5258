"""Files of the programs that calibrate cameras and rigs: Kalibr, mrcal, basalt, OpenVINS, ROVIO, CamOdoCal and more."""
