//! Sparse symmetric systems of 3 × 3 blocks, solved by block elimination in the order of the least degree.
//!
//! The order is that of W. Tinney, J. Walker, "Direct Solutions of Sparse Network Equations by Optimally Ordered
//! Triangular Factorization", Proceedings of the IEEE 1967. Most poses of a graph are leaves between two anchors and
//! leave no fill. A large system is solved in parts.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use nalgebra::{Matrix3, Vector3};

/// `H x = b`, `H` symmetric and positive definite.
#[derive(Clone, Debug)]
pub(super) struct BlockSystem {
    diagonal: Vec<Matrix3<f64>>,
    /// Of each row, the blocks off the diagonal, sorted by column. Both halves are kept.
    rows: Vec<Vec<(u32, Matrix3<f64>)>>,
    right: Vec<Vector3<f64>>,
    /// Rows to eliminate, with their degrees; those whose degree has changed since are passed over.
    next: BinaryHeap<Reverse<(usize, u32)>>,
    eliminated: Vec<Eliminated>,
    is_eliminated: Vec<bool>,
}

/// A row, the inverse of its block of the diagonal, and its other blocks.
type Eliminated = (u32, Matrix3<f64>, Vec<(u32, Matrix3<f64>)>);

impl BlockSystem {
    /// With `size` block rows of zeros.
    pub(super) fn new(size: usize) -> Self {
        Self {
            diagonal: vec![Matrix3::zeros(); size],
            rows: vec![Vec::new(); size],
            right: vec![Vector3::zeros(); size],
            next: BinaryHeap::new(),
            eliminated: Vec::with_capacity(size),
            is_eliminated: vec![false; size],
        }
    }

    /// Adds to a block of the diagonal.
    pub(super) fn add_diagonal(&mut self, row: u32, block: &Matrix3<f64>) {
        self.diagonal[row as usize] += block;
    }

    /// Adds to a block off the diagonal, and its transpose to the opposite one.
    pub(super) fn add_pair(&mut self, row: u32, column: u32, block: &Matrix3<f64>) {
        self.add_block(row, column, block);
        self.add_block(column, row, &block.transpose());
    }

    /// Adds to the right side.
    pub(super) fn add_right(&mut self, row: u32, part: &Vector3<f64>) {
        self.right[row as usize] += part;
    }

    fn add_block(&mut self, row: u32, column: u32, block: &Matrix3<f64>) {
        let row = &mut self.rows[row as usize];
        match row.binary_search_by_key(&column, |(other, _)| *other) {
            Ok(at) => row[at].1 += block,
            Err(at) => row.insert(at, (column, *block)),
        }
    }

    /// Goes on by at most so many rows; returns whether all are eliminated. Nothing may be added between.
    pub(super) fn eliminate(&mut self, most: usize) -> bool {
        if self.eliminated.is_empty() {
            let degrees = self.rows.iter().zip(0..);
            self.next = degrees.map(|(row, at)| Reverse((row.len(), at))).collect();
        }
        let end = self.rows.len().min(self.eliminated.len() + most);
        while self.eliminated.len() < end {
            let Some(Reverse((degree, pivot))) = self.next.pop() else {
                break;
            };
            let at = pivot as usize;
            if self.is_eliminated[at] || degree != self.rows[at].len() {
                continue;
            }
            self.is_eliminated[at] = true;
            let inverse = self.diagonal[at]
                .try_inverse()
                .unwrap_or_else(Matrix3::zeros);
            let row = std::mem::take(&mut self.rows[at]);
            let right = self.right[at];
            for (i, (j, block)) in row.iter().enumerate() {
                let factor = block.transpose() * inverse;
                self.right[*j as usize] -= factor * right;
                self.diagonal[*j as usize] -= factor * block;
                let neighbours = &mut self.rows[*j as usize];
                if let Ok(place) = neighbours.binary_search_by_key(&pivot, |(other, _)| *other) {
                    neighbours.remove(place);
                }
                for (k, other) in &row[i + 1..] {
                    self.add_pair(*j, *k, &-(factor * other));
                }
            }
            for (j, _) in &row {
                self.next.push(Reverse((self.rows[*j as usize].len(), *j)));
            }
            self.eliminated.push((pivot, inverse, row));
        }
        self.eliminated.len() == self.rows.len()
    }

    /// The solution, after all rows were eliminated; zero for rows that are singular.
    pub(super) fn solution(&self) -> Vec<Vector3<f64>> {
        let mut solution = vec![Vector3::zeros(); self.right.len()];
        for (pivot, inverse, row) in self.eliminated.iter().rev() {
            let known = row.iter().map(|(j, block)| block * solution[*j as usize]);
            let rest = known.fold(self.right[*pivot as usize], |rest, known| rest - known);
            solution[*pivot as usize] = inverse * rest;
        }
        solution
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, DVector};

    use super::*;

    #[test]
    fn the_solution_is_that_of_a_dense_system() {
        let size = 12;
        let mut system = BlockSystem::new(size);
        let mut dense = DMatrix::zeros(3 * size, 3 * size);
        let mut right = DVector::zeros(3 * size);
        let number = |seed: usize| libm::sin(1.0 + 7.3 * seed as f64);
        let mut add = |from: usize, to: usize, seed: usize| {
            // JᵀJ of an edge, so that the whole is positive definite.
            let block = |seed| Matrix3::from_fn(|r, c| number(seed + 3 * r + c));
            let (a, b) = (block(seed), block(seed + 9));
            system.add_diagonal(from as u32, &(a.transpose() * a));
            system.add_diagonal(to as u32, &(b.transpose() * b));
            system.add_pair(from as u32, to as u32, &(a.transpose() * b));
            let mut jacobian = DMatrix::zeros(3, 3 * size);
            jacobian.view_mut((0, 3 * from), (3, 3)).copy_from(&a);
            jacobian.view_mut((0, 3 * to), (3, 3)).copy_from(&b);
            dense += jacobian.transpose() * jacobian;
        };
        for at in 1..size {
            add(at - 1, at, 20 * at);
        }
        for (seed, (from, to)) in [(0, 7), (2, 11), (3, 9), (9, 1), (0, 11)]
            .into_iter()
            .enumerate()
        {
            add(from, to, 1000 + 20 * seed);
        }
        for at in 0..size {
            system.add_diagonal(at as u32, &(Matrix3::identity() * 0.1));
            let part = Vector3::new(number(at), number(at + 50), number(at + 90));
            system.add_right(at as u32, &part);
            right.rows_mut(3 * at, 3).copy_from(&part);
        }
        dense += DMatrix::identity(3 * size, 3 * size) * 0.1;
        let expected = dense.cholesky().unwrap().solve(&right);
        // In parts of any size.
        while !system.eliminate(5) {}
        for (at, part) in system.solution().iter().enumerate() {
            let error = (part - expected.fixed_rows::<3>(3 * at)).norm();
            assert!(error < 1e-9, "row {at}: {error}");
        }
    }
}
