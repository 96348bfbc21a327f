//! The cells of the dual grid: the eight leaves about each corner of the octree.
//!
//! The recursion is that of Schaefer and Warren (Proc. Pacific Graphics 2004). A state holds the
//! eight nodes about a place; along an axis that is not fixed yet, the two nodes are one. Each step
//! goes to the children that touch the place, and puts every free axis into the low half, into the
//! high half, or onto the plane between: 27 states below a node, 9 below a face, 3 below an edge, 1
//! below a corner.

use crate::field::{INSIDE, OUTSIDE};
use puncta_shared_octree::Node;

/// Eight nodes, by octant: bit a is set on the high side along axis a.
pub type Octants = [u32; 8];

/// Eight nodes about a place, and the axes along which the place lies between two of them.
#[derive(Clone, Copy, Debug)]
pub struct State {
    nodes: Octants,
    fixed: u8,
}

/// The tree and the sides of its nodes.
#[derive(Clone, Copy)]
pub struct Walk<'a> {
    /// Nodes.
    pub nodes: &'a [Node],
    /// Sides of the leaves below each node.
    pub sides: &'a [u8],
}

impl Walk<'_> {
    /// States from which all cells can be reached that the surface passes, in order.
    #[must_use]
    pub fn start(&self, enough: usize) -> Vec<State> {
        let mut states = vec![State {
            nodes: [0; 8],
            fixed: 0,
        }];
        for _ in 0..puncta_shared_octree::BITS {
            if states.len() >= enough {
                break;
            }
            let mut next = Vec::with_capacity(8 * states.len());
            for state in &states {
                if self.is_cell(state) {
                    next.push(*state);
                } else {
                    self.below(state, &mut |state| next.push(state));
                }
            }
            states = next;
        }
        states
    }

    /// Calls `visit` with each cell below a state that the surface passes.
    pub fn cells(&self, state: &State, visit: &mut dyn FnMut(&Octants)) {
        if self.is_cell(state) {
            visit(&state.nodes);
        } else {
            self.below(state, &mut |state| self.cells(&state, visit));
        }
    }

    fn is_cell(&self, state: &State) -> bool {
        state.fixed == 7 && state.nodes.iter().all(|at| self.is_leaf(*at))
    }

    fn is_leaf(&self, at: u32) -> bool {
        self.nodes[at as usize].is_leaf()
    }

    /// Calls `visit` with the states below a state, but those on one side and those without corners.
    fn below(&self, state: &State, visit: &mut dyn FnMut(State)) {
        if state.nodes.iter().all(|at| self.is_leaf(*at)) {
            return;
        }
        for choice in 0..27usize {
            // 0: low half, 1: high half, 2: between.
            let choices = [choice % 3, choice / 3 % 3, choice / 9];
            let fixed = |axis: usize| state.fixed >> axis & 1 == 1;
            if (0..3).any(|axis| fixed(axis) && choices[axis] != 0) {
                continue;
            }
            let mut next = *state;
            for (axis, choice) in choices.into_iter().enumerate() {
                next.fixed |= u8::from(choice == 2) << axis;
            }
            let mut sides = 0;
            for (octant, at) in next.nodes.iter_mut().enumerate() {
                if !self.is_leaf(*at) {
                    let mut child = 0;
                    for (axis, choice) in choices.into_iter().enumerate() {
                        let high = octant >> axis & 1;
                        let bit = match choice {
                            _ if fixed(axis) => 1 - high,
                            2 => high,
                            half => half,
                        };
                        child |= bit << axis;
                    }
                    *at = self.nodes[*at as usize].child + child as u32;
                }
                sides |= self.sides[*at as usize];
            }
            if sides == INSIDE | OUTSIDE {
                visit(next);
            }
        }
    }
}
