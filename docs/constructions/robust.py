"""One construction of each class of `jaxspace.robust`, as the reference shows them."""

from jaxspace.robust.statistics import (
    Constraint,
    CVaR,
    Mean,
    MeanPlus,
    Quantile,
    Violation,
    Worst,
)

Mean("height")
MeanPlus("height", k=2.0)
Quantile("height", share=0.01)
CVaR("miss", share=0.9)
Worst("miss")
Violation("load", high=5e4)
Constraint(Quantile("load", share=0.99), limit=5e4, upper=True)
