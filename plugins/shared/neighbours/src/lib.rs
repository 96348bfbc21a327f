//! Neighbours of points: a grid of cells for radius and nearest-neighbour queries in two and three dimensions.
