"""One construction of each class of `jaxspace.sampling`, as the reference shows them."""

from jaxspace.sampling import (
    ConeDirection,
    Constant,
    Correlated,
    Discrete,
    LatinHypercube,
    Lognormal,
    MultivariateNormal,
    Normal,
    Samples,
    Sobol,
    Triangular,
    TruncatedNormal,
    Uniform,
)
from jaxspace.sampling.sweeps import Sweep

Normal(mean=1.0, deviation=0.02)
TruncatedNormal(mean=1.0, deviation=0.02, low=0.95, high=1.05)
Lognormal(mean=1.0, deviation=0.1)
Uniform(low=-0.002, high=0.002)
Triangular(mode=0.2, low=0.0, high=1.0)
Discrete(values=[0.0, 7.0], weights=[0.9, 0.1])
Samples(values=[3.0, 1.0, 2.0, 4.0])
Constant(value=9.81)
ConeDirection(vector=[0.0, 0.0, 1.0], half_angle=0.02)
MultivariateNormal(mean=[0.0, 0.0], covariance=[[1.0, 0.5], [0.5, 4.0]])
marginals = Normal(mean=0.0, deviation=1.0), Uniform(low=-1.0, high=1.0)
Correlated.of(marginals, [[1.0, 0.5], [0.5, 1.0]])
LatinHypercube(runs=1000)
Sobol()
Sweep(columns={"drag": [0.4, 0.5, 0.6]})
