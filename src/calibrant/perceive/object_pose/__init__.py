"""Where things of known shape are, from a colour picture and depth, with covariance and symmetries."""
