"""The reprojection factor and what surrounds it: links, kernels, outliers, weights, priors."""
