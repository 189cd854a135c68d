//! Result + truth → numbers and charts.
