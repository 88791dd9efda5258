"""The linear and classical methods of the lecture, a public function each; docs/classical-methods.md compares them."""

from calibrant.calibrate.classical.dlt import calibrate_dlt as calibrate_dlt
from calibrant.calibrate.classical.dlt import decompose as decompose
from calibrant.calibrate.classical.dlt import dlt as dlt
from calibrant.calibrate.classical.fast_rac import calibrate_fast_rac as calibrate_fast_rac
from calibrant.calibrate.classical.points import ClassicalCalibration as ClassicalCalibration
from calibrant.calibrate.classical.radial import slide_k as slide_k
from calibrant.calibrate.classical.refusals import Degenerate as Degenerate
from calibrant.calibrate.classical.stereo import stereo_points as stereo_points
from calibrant.calibrate.classical.tsai import calibrate_tsai as calibrate_tsai
from calibrant.calibrate.classical.tsai import calibrate_tsai_coplanar as calibrate_tsai_coplanar
from calibrant.calibrate.classical.zhang import calibrate_zhang as calibrate_zhang
from calibrant.calibrate.classical.zhang import calibrate_zhang_one_view as calibrate_zhang_one_view
from calibrant.calibrate.classical.zhang import zhang_distortion as zhang_distortion
