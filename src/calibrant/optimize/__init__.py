"""Floor 1: block-sparse nonlinear least squares on manifolds; knows no cameras.

Build a `Problem` of `Variable`s and `Factor`s, `solve` it, ask the `Solution` for values and covariances;
`estimate_noise` finds the noise levels too.
"""

from calibrant.optimize.consistency import ChiSquare as ChiSquare
from calibrant.optimize.consistency import chi_squares as chi_squares
from calibrant.optimize.factors import Factor as Factor
from calibrant.optimize.factors import FactorBlocks as FactorBlocks
from calibrant.optimize.factors import RotationPrior as RotationPrior
from calibrant.optimize.factors import TranslationPrior as TranslationPrior
from calibrant.optimize.factors import VectorPrior as VectorPrior
from calibrant.optimize.graduated import Graduated as Graduated
from calibrant.optimize.graduated import solve_graduated as solve_graduated
from calibrant.optimize.levenberg_marquardt import SolverOptions as SolverOptions
from calibrant.optimize.levenberg_marquardt import Status as Status
from calibrant.optimize.levenberg_marquardt import solve as solve
from calibrant.optimize.losses import Loss as Loss
from calibrant.optimize.manifolds import SE3 as SE3
from calibrant.optimize.manifolds import SO3 as SO3
from calibrant.optimize.manifolds import Euclidean as Euclidean
from calibrant.optimize.manifolds import Interval as Interval
from calibrant.optimize.manifolds import Manifold as Manifold
from calibrant.optimize.manifolds import Positive as Positive
from calibrant.optimize.manifolds import Subspace as Subspace
from calibrant.optimize.manifolds import Variable as Variable
from calibrant.optimize.manifolds import vector as vector
from calibrant.optimize.noise import NoiseEstimate as NoiseEstimate
from calibrant.optimize.noise import NoiseLevel as NoiseLevel
from calibrant.optimize.noise import estimate_noise as estimate_noise
from calibrant.optimize.problem import Problem as Problem
from calibrant.optimize.solution import Solution as Solution
from calibrant.optimize.unobservable import Unobservable as Unobservable
