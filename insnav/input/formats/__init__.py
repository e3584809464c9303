"""Data formats: conversion of any supported file to a table, chosen by its first bytes."""
