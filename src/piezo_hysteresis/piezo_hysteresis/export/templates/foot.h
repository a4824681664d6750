#ifdef __cplusplus
}
#endif

#endif /* $UPPER$_H */
