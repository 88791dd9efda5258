"""How certain a cell's result is beside what its noise levels say: errors that poses, views and robots share."""
